"""What moves the robot of a run: wheels that roll, that slip, or another simulator."""
