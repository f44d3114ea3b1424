"""The closed loop, its log and its figures of merit."""
