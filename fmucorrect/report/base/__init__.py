"""What the pages of all jobs are made of: one HTML file, figures and their still pictures, numbers in words."""
