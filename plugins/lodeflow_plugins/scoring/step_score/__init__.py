"""Counted steps against the true ones."""
