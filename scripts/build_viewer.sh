#!/bin/sh
# Builds pix2face/assets/viewer/viewer.js from scripts/viewer/ with the packages of its package-lock.json, whose
# integrity hashes npm checks. Needs Node.js and npm; only whoever changes the viewer needs to run it.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
out="$here/../pix2face/assets/viewer"

cd "$here/viewer"
npm ci --no-audit --no-fund
mkdir -p "$out"
# Keeps the licence comment of three. The page supports browsers from 2021 on.
node_modules/.bin/esbuild viewer.js --bundle --minify --format=iife --target=es2021 --charset=ascii \
    --legal-comments=inline --outfile="$out/viewer.js"
cp node_modules/three/LICENSE "$out/LICENSE-three.txt"
(cd "$out" && sha256sum viewer.js)
