"""ROS 1 bags, ROS 2 bags and MCAP: topics of tactile messages as recordings."""
