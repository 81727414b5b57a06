"""Networks made ready for use on the processor: fewer steps, weights as its convolutions want them, bfloat16."""

from typing import final

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pix2face.networks.architectures import SCALE_PLANE
from pix2face.networks.residual import ResidualUNet, folded


def packed(network: nn.Module, precision: torch.dtype | None = None) -> nn.Module:
    """A network in use that computes the same faster on the processor; the argument is changed.

    Its norms are folded into its convolutions, and the weights are laid out in memory once instead of at every call.
    The plane of scales is left out, since it serves the training alone. The last convolution and the landmarks stay in
    float32, so that the maps are as smooth as they were.

    Networks of another architecture than ``residual`` come back as they are, and so does any network where torch was
    built without oneDNN.

    Args:
        network: Network with its weights, on the CPU.
        precision: Of the other convolutions; None chooses bfloat16 if the processor computes in it, otherwise float32.
    """
    if not (isinstance(network, ResidualUNet) and torch.backends.mkldnn.is_available()):  # type: ignore[no-untyped-call]
        return network
    ready = folded(network)
    _keep_planes(ready.planes, SCALE_PLANE)
    precision = precision or (torch.bfloat16 if _has_bfloat16() else torch.float32)
    for module in list(ready.modules()):
        for name, child in list(module.named_children()):
            if isinstance(child, nn.Conv2d):
                is_last = child is ready.planes
                setattr(module, name, PackedConvolution(child, torch.float32 if is_last else precision))
    return ready


@final
class PackedConvolution(nn.Module):
    """A convolution whose weights lie in memory as oneDNN reads them, which takes a third of the time of a face.

    Args:
        convolution: The convolution that it replaces.
        precision: Type of its weights and its output.
    """

    def __init__(self, convolution: nn.Conv2d, precision: torch.dtype) -> None:
        super().__init__()
        self._weight = convolution.weight.detach().to(precision)
        self._bias = None if convolution.bias is None else convolution.bias.detach().to(precision)
        self._place = (convolution.padding, convolution.stride, convolution.dilation, convolution.groups)

    def forward(self, features: Float[Tensor, "b c y x"]) -> Float[Tensor, "b d v u"]:
        """Converts the features to its precision and convolves them."""
        # The operations that torch.compile makes of a convolution, without its compiler.
        weight = self._weight
        if not weight.is_mkldnn:  # the best layout depends on the size of the picture
            weight = torch.ops.mkldnn._reorder_convolution_weight(weight, *self._place, [1, *features.shape[1:]])
            self._weight = weight
        answer: Tensor = torch.ops.mkldnn._convolution_pointwise(
            features.to(weight.dtype), weight, self._bias, *self._place, "none", [], ""
        )
        return answer


def _keep_planes(convolution: nn.Conv2d, count: int) -> None:
    """Leaves at most so many planes of the answer, which has four pixels of a plane in a row."""
    convolution.weight = nn.Parameter(convolution.weight[: 4 * count])
    if convolution.bias is not None:
        convolution.bias = nn.Parameter(convolution.bias[: 4 * count])


def _has_bfloat16() -> bool:
    """Whether the processor multiplies in bfloat16, as far as this version of torch can tell."""
    capabilities: dict[str, object] = getattr(torch.cpu, "get_capabilities", dict)()
    return bool(capabilities.get("avx512_bf16"))
