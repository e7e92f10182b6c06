"""Filters of other packages as nodes, in the place of `chu_fuser`; they need the extra `peers`."""
