"""Places that images and volumes have in common: windows, histograms, descriptors, matches."""
