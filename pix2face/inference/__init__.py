"""From a checkpoint to maps."""
