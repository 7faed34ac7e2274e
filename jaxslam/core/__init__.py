"""Shared building blocks: poses, scans, flags, 3 × 3 linear algebra and parameter checks."""
