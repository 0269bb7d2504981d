"""The demo, the tables, the figures and the benchmarks."""

from labeling.runtime.start_up import expect_interrupts

expect_interrupts()
