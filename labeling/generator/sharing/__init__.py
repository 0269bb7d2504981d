"""Episodes of a scene, labelled together or sharing their labels."""
