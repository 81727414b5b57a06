// The networks of the page, run by onnxruntime-web. All files lie in script elements as base64 of gzip.

import { env, InferenceSession, Tensor } from "onnxruntime-web/wasm";

// Opens the detector (`find`) and the network for faces: its first half (`encode`), which answers the landmarks that it
// predicts itself, and its second (`decode`), which adds the maps. `report` is told what is being done.
export async function openNetworks(report) {
  await report("Loading onnxruntime…");
  env.wasm.numThreads = 1; // more need a server that sends special headers
  env.wasm.wasmBinary = await unpacked("runtime");
  await report("Loading the face detector…");
  const find = await openNetwork("detector");
  await report("Loading the network…");
  return { find, encode: await openNetwork("network"), decode: await openDecoder() };
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

const openSession = async (id) => InferenceSession.create(await unpacked(id), { executionProviders: ["wasm"] });

// A function from planes (3, height, width) to the outputs of the network by name.
async function openNetwork(id) {
  const session = await openSession(id);
  const [input] = session.inputNames;
  return async (planes, width, height) => session.run({ [input]: new Tensor("float32", planes, [1, 3, height, width]) });
}

// A function from the outputs of the first half of the network to those of both; some networks are in one part.
async function openDecoder() {
  if (!document.getElementById("decoder")) return (outputs) => outputs;
  const session = await openSession("decoder");
  return async (outputs) => {
    const features = session.inputNames.map((name) => [name, outputs[name]]);
    return { ...outputs, ...(await session.run(Object.fromEntries(features))) };
  };
}
