"""Drawing faces: poses, cameras, crops, expressions, identities."""
