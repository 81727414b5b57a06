#!/bin/sh
# Gets a browser for the tests of the pages, where that is possible without asking: as root, by apt. Never fails: without
# a browser those tests are skipped, and say so. PIX2FACE_NO_BROWSER=1 leaves everything as it is.
set -u

for name in chromium chromium-browser google-chrome google-chrome-stable; do
    if command -v "$name" >/dev/null; then exit 0; fi
done
if [ -n "${PIX2FACE_NO_BROWSER:-}" ] || [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
    echo "no Chromium: the tests that open pages in a browser will be skipped"
    exit 0
fi
echo "installing Chromium for the tests of the pages (PIX2FACE_NO_BROWSER=1 goes without)"
export DEBIAN_FRONTEND=noninteractive
if timeout 60 apt-get update -qq && timeout 240 apt-get install -qq -y --no-install-recommends chromium >/dev/null; then
    exit 0
fi
echo "Chromium could not be installed: the tests that open pages in a browser will be skipped"
exit 0
