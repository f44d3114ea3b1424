"""Pages of one HTML file: the report, the robot, a certificate."""
