"""Recordings: MCAP files of ROS 2 messages, written and read as columns."""
