"""Steps of the plant as statements of a program."""
