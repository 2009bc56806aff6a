"""On-line estimation: regressions, solvers, the bank, and the choice of the model to stream."""
