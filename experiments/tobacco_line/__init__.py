"""Liang et al.: the improved filter with 15 particles against other filters with more particles."""
