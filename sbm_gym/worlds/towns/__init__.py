"""Towns: streets, houses, vehicles, weather."""
