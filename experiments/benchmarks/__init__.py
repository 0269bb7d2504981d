"""Speed beside baselines."""
