"""The Gymnasium environment: episodes, observations, rewards, recording."""
