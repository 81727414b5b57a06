"""The shard format: what a sample holds, how it is stored, written, read and checked."""
