"""The demo, the tables, the figures and the benchmarks."""
