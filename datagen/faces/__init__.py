"""Where faces come from: coefficient files, 300W-LP, annotated photographs."""
