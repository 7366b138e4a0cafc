"""Array functions: numpy in, numpy out, no objects and no state. Each file imports numpy and nothing else."""
