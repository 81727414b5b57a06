# pix2face on the CPU; Dockerfile.nvidia is for NVIDIA GPUs. How to use both: docs/how_to/containers.md
#   docker build -t pix2face .
#   docker run --rm -v "$PWD:/data" pix2face pix2face fit photo.jpg
FROM python:3.11-slim-bookworm AS build

# The default index has torch with CUDA, which is gigabytes larger and runs on the CPU as well. Name an index of CPU
# wheels with --build-arg PIP_EXTRA_INDEX_URL=... to leave CUDA out.
ARG PIP_EXTRA_INDEX_URL=
ARG EXTRAS=heic,train
WORKDIR /source
COPY pyproject.toml constraints.txt README.md LICENSE ASSETS.md ./
COPY manifests manifests
COPY pix2face pix2face
COPY datagen datagen
COPY training training
RUN python -m venv /opt/pix2face \
 && /opt/pix2face/bin/pip install --no-cache-dir --no-input --constraint constraints.txt ".[${EXTRAS}]"

FROM python:3.11-slim-bookworm

# hadolint ignore=DL3008
RUN apt-get update \
 && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends \
    libegl1 libgl1 libgl1-mesa-dri libosmesa6 \
 && rm -rf /var/lib/apt/lists/* \
 && useradd --uid 1000 --create-home pix2face \
 && install -d -o pix2face -g pix2face /data
COPY --from=build /opt/pix2face /opt/pix2face
# With --user, the user of the container may be any number, which has no home.
ENV PATH=/opt/pix2face/bin:$PATH HOME=/tmp PYTHONUNBUFFERED=1
USER 1000
WORKDIR /data
VOLUME /data
# One of the four programs: pix2face, datagen, train or evaluate
CMD ["pix2face", "--help"]
