"""The contact trial: the robot as a free body on a plane, beside the reduced model."""
