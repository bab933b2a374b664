"""The algebra of clusters: members, means, subspaces, components, blends."""
