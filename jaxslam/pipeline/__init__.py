"""Build a filter from a log and a configuration, and run it to a result."""
