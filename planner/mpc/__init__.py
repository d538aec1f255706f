"""MPC: plan a motion along the line that ends stopped."""
