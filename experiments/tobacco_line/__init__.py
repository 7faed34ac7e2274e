"""The first paper's experiment: the improved filter with 15 particles against others with more."""
