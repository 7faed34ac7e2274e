"""Everything that a user sets, without any algorithm."""
