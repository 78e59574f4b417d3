"""The page of `identify`: residual before and after, what was tried, and what stays open."""
