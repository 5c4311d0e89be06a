"""What runs give: trajectories, metrics, objectives, and what engineers read off them."""
