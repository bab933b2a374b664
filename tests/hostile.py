"""Asset files that pretend."""

import json

import safetensors
import safetensors.torch


def hostile(path, change) -> None:
    """Rewrites an asset's header and tensors through `change(header, tensors)`."""
    with safetensors.safe_open(path, framework="pt") as file:
        header = json.loads(file.metadata()["diffprt"])
    tensors = safetensors.torch.load_file(path)
    change(header, tensors)
    tensors = {name: tensor.contiguous() for name, tensor in tensors.items()}
    safetensors.torch.save_file(tensors, path, metadata={"diffprt": json.dumps(header)})
