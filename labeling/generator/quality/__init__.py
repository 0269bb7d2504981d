"""Quality of labels, regions to ignore, and completed boxes."""
