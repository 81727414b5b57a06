"""What a training depends on."""
