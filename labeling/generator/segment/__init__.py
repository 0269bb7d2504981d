"""Which points are an object's: classifiers on seeds, and a fully-connected CRF."""
