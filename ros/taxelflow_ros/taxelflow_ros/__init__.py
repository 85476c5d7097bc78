"""taxelflow as a ROS 2 node."""
