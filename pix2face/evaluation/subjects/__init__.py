"""What is measured: a network, the landmarks of another system, the model fitted to the truth."""
