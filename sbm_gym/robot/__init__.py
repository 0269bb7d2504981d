"""The robot's body, and what it knows from its own senses."""
