#!/bin/sh
# Installs a browser for the tests of HTML pages, with apt if it runs as root. It never fails: without a browser, these
# tests are skipped with a reason. PIX2FACE_NO_BROWSER=1 installs nothing.
set -u

for name in chromium chromium-browser google-chrome google-chrome-stable; do
    if command -v "$name" >/dev/null; then exit 0; fi
done
if [ -n "${PIX2FACE_NO_BROWSER:-}" ] || [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
    echo "no Chromium: the tests that open pages in a browser will be skipped"
    exit 0
fi
echo "installing Chromium for the tests of the pages (PIX2FACE_NO_BROWSER=1 skips this)"
export DEBIAN_FRONTEND=noninteractive
if timeout 60 apt-get update -qq && timeout 240 apt-get install -qq -y --no-install-recommends chromium >/dev/null; then
    exit 0
fi
echo "Chromium could not be installed: the tests that open pages in a browser will be skipped"
exit 0
