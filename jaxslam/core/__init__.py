"""What everything else is made of: poses, scans, flags, small matrices and checks."""
