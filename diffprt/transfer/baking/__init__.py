"""From a scene to its transfer: options, costs, chunks."""
