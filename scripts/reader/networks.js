// The two networks of the page, run by onnxruntime-web. All files lie in script elements as base64 of gzip.

import { env, InferenceSession, Tensor } from "onnxruntime-web/wasm";

// Opens the detector and the network for faces; `report` is told what is being done.
export async function openNetworks(report) {
  await report("Loading onnxruntime…");
  env.wasm.numThreads = 1; // more need a server that sends special headers
  env.wasm.wasmBinary = await unpacked("runtime");
  await report("Loading the face detector…");
  const find = await openNetwork("detector");
  await report("Loading the network…");
  return { find, predict: await openNetwork("network") };
}

// Takes the content of a script element out of the page, which frees its memory.
export async function unpacked(id) {
  const element = document.getElementById(id);
  const text = atob(element.textContent.trim());
  element.remove();
  const packed = new Uint8Array(text.length);
  for (let i = 0; i < packed.length; i++) packed[i] = text.charCodeAt(i);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// A function from planes (3, height, width) to the outputs of the network by name.
async function openNetwork(id) {
  const session = await InferenceSession.create(await unpacked(id), { executionProviders: ["wasm"] });
  const [input] = session.inputNames;
  return async (planes, width, height) => session.run({ [input]: new Tensor("float32", planes, [1, 3, height, width]) });
}
