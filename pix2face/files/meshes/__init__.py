"""The containers of meshes and points: `.glb` and `.ply`."""
