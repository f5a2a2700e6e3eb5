"""The printed formulations of the thesis, kept as references for tests and benchmarks."""
