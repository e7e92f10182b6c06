"""Supervisor: runs a graph from its start to a closed recording and a summary."""
