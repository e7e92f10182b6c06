"""Graph files: from YAML to a checked description that holds no live object."""
