"""Segmentation of objects in the cloud: classifiers trained on seeds, a fully connected CRF, thin parts."""
