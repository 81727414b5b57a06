"""Training: shards in, a U-Net checkpoint out."""
