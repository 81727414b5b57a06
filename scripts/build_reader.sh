#!/bin/sh
# Builds the files of pix2face/assets/reader from scripts/reader/ and the packages of its package-lock.json, whose
# integrity hashes npm checks. Needs Node.js and npm; only whoever changes the page of `pix2face page` needs to run it.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
out="$here/../pix2face/assets/reader"

cd "$here/reader"
npm ci --no-audit --no-fund
# Keeps the licence comment of the runtime. Browsers that can decompress gzip are from 2023 or newer.
node_modules/.bin/esbuild reader.js --bundle --minify --format=iife --target=es2022 --charset=ascii \
    --log-override:empty-import-meta=silent --legal-comments=inline --outfile="$out/reader.js"
gzip -9nc node_modules/onnxruntime-web/dist/ort-wasm-simd-threaded.wasm >"$out/onnxruntime.wasm.gz"
(cd "$out" && sha256sum reader.js onnxruntime.wasm.gz)
