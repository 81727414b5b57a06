"""What faces, light and surroundings look like in synthetic photographs."""
