"""How good landmarks are: benchmarks, metrics, reports, comparisons."""
