"""Caches on disk that all processes share: memory-mapped files of arrays, with checksums and a bound on their size."""
