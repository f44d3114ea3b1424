"""Slip and tipping on trial: where the reduced model predicts them, and where contact has them."""
