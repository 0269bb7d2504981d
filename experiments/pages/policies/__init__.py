"""The page about policies, a module for each of its parts."""
