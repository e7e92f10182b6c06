"""Studies: a graph run over a grid of changes, in parallel, into tables and figures."""
