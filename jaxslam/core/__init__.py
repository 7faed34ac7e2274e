"""Building blocks of every other package: poses, scans, flags, small matrices and parameter checks."""
