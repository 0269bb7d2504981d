"""Training a policy with PPO: workers, network, callbacks, and the files of a run."""
