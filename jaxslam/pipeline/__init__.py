"""From a log and a configuration to a filter, and from the filter to a result."""
