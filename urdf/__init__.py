"""Model data: a right knee (femur, tibia, both) as URDF files with bone tunnels, and its generator."""
