"""The `jaxslam` command; each command is one file with its flags and its code."""
