"""Random poses, cameras, crops, expressions and identities of faces."""
