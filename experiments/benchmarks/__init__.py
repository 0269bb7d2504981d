"""Benchmarks: times and memory, compared with baselines."""
