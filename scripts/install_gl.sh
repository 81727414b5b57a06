#!/bin/sh
# Makes sure that OpenGL works without a display: with EGL of Mesa, and OSMesa as fallback. Installs them with apt if it
# runs as root, and otherwise prints the command to run.
set -eu

PACKAGES="libegl1 libgl1 libgl1-mesa-dri libosmesa6"

has() { ldconfig -p | grep -q "$1"; }

if has libEGL.so.1 && has libOSMesa.so; then
    exit 0
fi
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    echo "installing OpenGL without a display: $PACKAGES"
    apt-get update -qq
    # shellcheck disable=SC2086 # a list of packages
    DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends $PACKAGES >/dev/null
    exit 0
fi
if has libEGL.so.1 || has libOSMesa.so; then
    echo "only one of EGL and OSMesa is installed, which is enough. For both: sudo apt-get install $PACKAGES"
    exit 0
fi
echo "no OpenGL without a display was found; run: sudo apt-get install $PACKAGES" >&2
exit 1
