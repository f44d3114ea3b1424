"""Independent derivations of the dynamics, and the certificate that compares them."""
