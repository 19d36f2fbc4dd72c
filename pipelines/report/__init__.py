"""Reports for people: one HTML file that opens without a network."""
