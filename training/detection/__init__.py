"""Training of the face detector: rendered people over pictures without people, composed while the network learns."""
