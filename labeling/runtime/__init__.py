"""What programs need around their work: command lines, threads, processes, run folders, provenance."""
