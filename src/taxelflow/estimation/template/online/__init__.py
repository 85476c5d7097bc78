"""The template scan by scan: track, choose keyframes, update the map."""
