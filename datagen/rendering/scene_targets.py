"""What a scene is drawn into: colours with smooth edges, and labels of pixel centres."""

from dataclasses import dataclass
from typing import final

import cv2
import moderngl
import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

SAMPLES = 4
# Where the driver has no floating-point colours of several samples, pictures are drawn this much finer instead.
OVERSAMPLING = 2


@final
@dataclass(frozen=True, eq=False)
class SceneTarget:
    """Framebuffers for one size of picture.

    Attributes:
        colours: Drawn into; four samples a pixel, or finer.
        resolved: One sample a pixel of it, or itself.
        labels: One number a pixel, with a depth of its own.
        finer: How many of its pixels a pixel of the picture has in each direction.
    """

    colours: moderngl.Framebuffer
    resolved: moderngl.Framebuffer
    labels: moderngl.Framebuffer
    finer: int
    height: int
    width: int

    def read_colours(self, context: moderngl.Context) -> Float32[ndarray, "h w 4"]:
        """Radiance multiplied by coverage, and coverage."""
        if self.resolved is not self.colours:
            context.copy_framebuffer(self.resolved, self.colours)
        fine = (self.finer * self.height, self.finer * self.width, 4)
        drawn = np.frombuffer(self.resolved.read(components=4, dtype="f4"), dtype=np.float32).reshape(fine)
        if self.finer == 1:
            return drawn
        return np.asarray(cv2.resize(drawn, (self.width, self.height), interpolation=cv2.INTER_AREA), dtype=np.float32)

    def read_labels(self) -> UInt8[ndarray, "h w"]:
        """The label at the centre of each pixel."""
        data = self.labels.read(components=1, alignment=1)
        return np.frombuffer(data, dtype=np.uint8).reshape(self.height, self.width).copy()

    def release(self) -> None:
        """Gives everything back to the driver."""
        for framebuffer in {id(each): each for each in (self.colours, self.resolved, self.labels)}.values():
            attachments = [*framebuffer.color_attachments, framebuffer.depth_attachment]
            framebuffer.release()
            for attachment in attachments:
                if attachment is not None:
                    attachment.release()


def make_target(context: moderngl.Context, height: int, width: int, multisampled: bool = True) -> SceneTarget:
    """Framebuffers of four samples a pixel, or of 2 x 2 pixels for one where the driver has none of these."""
    size = (width, height)
    labels = context.framebuffer([context.renderbuffer(size, 1)], context.depth_renderbuffer(size))
    if multisampled and context.max_samples >= SAMPLES:
        try:
            colours = context.framebuffer(
                [context.renderbuffer(size, 4, samples=SAMPLES, dtype="f2")],
                context.depth_renderbuffer(size, samples=SAMPLES),
            )
        except moderngl.Error:
            context.error  # noqa: B018 - reading it clears it
        else:
            resolved = context.framebuffer([context.renderbuffer(size, 4, dtype="f2")])
            return SceneTarget(colours, resolved, labels, 1, height, width)
    fine = (OVERSAMPLING * width, OVERSAMPLING * height)
    colours = context.framebuffer([context.renderbuffer(fine, 4, dtype="f2")], context.depth_renderbuffer(fine))
    return SceneTarget(colours, colours, labels, OVERSAMPLING, height, width)
