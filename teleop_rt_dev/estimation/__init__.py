"""Plants and regressions, and the solvers of the estimators again in plain Python."""
