"""Prepares trained networks for fast inference on the CPU."""

from typing import final

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pix2face.networks.architectures import SCALE_PLANE
from pix2face.networks.residual import ResidualUNet, folded


def packed(network: nn.Module, precision: torch.dtype | None = None) -> nn.Module:
    """Prepares a network for inference on the CPU, which makes it about twice as fast with bfloat16.

    Batch norms are folded into the convolutions, and weights are laid out for oneDNN once instead of in every call. The
    plane of scales is left out, because only training needs it. The last convolution, the landmarks and the correction
    of fits stay in float32: in bfloat16, the maps would be rough.

    Networks of other architectures than ``residual`` are returned unchanged, and so are all networks if PyTorch was
    built without oneDNN.

    Args:
        network: Network with its weights, on the CPU. It is modified.
        precision: Type of all other convolutions. None means bfloat16 if the processor supports
            it, otherwise float32.
    """
    if not (isinstance(network, ResidualUNet) and torch.backends.mkldnn.is_available()):  # type: ignore[no-untyped-call]
        return network
    ready = folded(network)
    _keep_channels(ready.planes, 4 * SCALE_PLANE)  # of each plane, four for 2 x 2 pixels
    coarse = [own for own in ready.coarse_planes if isinstance(own, nn.Conv2d)]
    for convolution in coarse:
        _keep_channels(convolution, SCALE_PLANE)
    # What is answered, and the corrections of fits, need more digits than bfloat16 has.
    exact = {ready.planes, *coarse}
    if ready.correction is not None:
        exact |= {own for own in ready.correction.modules() if isinstance(own, nn.Conv2d)}
    precision = precision or (torch.bfloat16 if has_bfloat16() else torch.float32)
    for module in list(ready.modules()):
        for name, child in list(module.named_children()):
            if isinstance(child, nn.Conv2d):
                setattr(module, name, PackedConvolution(child, torch.float32 if child in exact else precision))
    return ready


@final
class PackedConvolution(nn.Module):
    """A convolution for inference whose weights stay in the memory layout of oneDNN.

    Args:
        convolution: The convolution to replace.
        precision: Type of its weights and its output.
    """

    def __init__(self, convolution: nn.Conv2d, precision: torch.dtype) -> None:
        super().__init__()
        self._weight = convolution.weight.detach().to(precision)
        self._bias = None if convolution.bias is None else convolution.bias.detach().to(precision)
        self._place = (convolution.padding, convolution.stride, convolution.dilation, convolution.groups)

    def forward(self, features: Float[Tensor, "b c y x"]) -> Float[Tensor, "b d v u"]:
        """Converts the features to the precision of the weights and convolves them."""
        # torch.compile replaces convolutions by the same two operations.
        weight = self._weight
        if not weight.is_mkldnn:  # the best layout depends on the size of the picture
            weight = torch.ops.mkldnn._reorder_convolution_weight(weight, *self._place, [1, *features.shape[1:]])
            self._weight = weight
        answer: Tensor = torch.ops.mkldnn._convolution_pointwise(
            features.to(weight.dtype), weight, self._bias, *self._place, "none", [], ""
        )
        return answer


def _keep_channels(convolution: nn.Conv2d, count: int) -> None:
    """Keeps at most the first ``count`` channels of the output."""
    convolution.weight = nn.Parameter(convolution.weight[:count])
    if convolution.bias is not None:
        convolution.bias = nn.Parameter(convolution.bias[:count])


def has_bfloat16() -> bool:
    """Whether the processor has instructions for bfloat16; False if this version of PyTorch cannot tell."""
    capabilities: dict[str, object] = getattr(torch.cpu, "get_capabilities", dict)()
    return bool(capabilities.get("avx512_bf16"))
