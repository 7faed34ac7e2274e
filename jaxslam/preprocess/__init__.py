"""Corrections of a log before it is filtered: ranges, motion during a scan, time lag, wheel odometry."""
