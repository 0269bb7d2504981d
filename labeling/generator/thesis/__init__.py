"""Labels as the thesis makes them: every detection by itself."""
