"""What is behind the people of synthetic photographs."""
