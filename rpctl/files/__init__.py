"""Files in and out: opened within caps, written whole or not at all."""
