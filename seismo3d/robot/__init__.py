"""Dense maps and trajectories from RGB-D cameras without odometry."""
