"""Recording: what a car or a robot sees on simulated drives, as samples, frames and scores."""
