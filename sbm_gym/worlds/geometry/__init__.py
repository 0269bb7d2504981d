"""Where things and agents can stand: floor grids, footprints, placement."""
