"""Messages: one declaration gives memory, wire layout, ROS 2 schema and documentation."""
