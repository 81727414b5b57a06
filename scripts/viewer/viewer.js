// Shows fitted faces over their photographs and lets the reader turn them. scripts/build_viewer.sh builds it into
// pix2face/assets/viewer/viewer.js.
//
// The page (pix2face/photographs/view_page.py) holds the faces as JSON in #faces; arrays are base64 of little-endian
// numbers. The model frame is three's: x to the subject's left, y up, z out of the face, mm. The camera of a face is
// weak-perspective: `rotation` is camera_from_model with y down and z forward, so the photograph's view is
// diag(1, -1, -1) times it; `px_per_mm` and `translation_px` lead to the pixels of the photograph that the page shows.
import {
  AmbientLight,
  BufferAttribute,
  BufferGeometry,
  DirectionalLight,
  Group,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  MeshLambertMaterial,
  OrthographicCamera,
  Points,
  PointsMaterial,
  Scene,
  SRGBColorSpace,
  Texture,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";

const SKIN = 0xc9b8a8;
// The camera stands this far from the middle of the head, which is always between its near and its far plane.
const DISTANCE_MM = 2000;
// What a face shows of itself in one photograph: points are made just large enough to cover it.
const SEEN_MM2 = 22000;
const LANDMARK_MM = 3;

const byId = (id) => document.getElementById(id);
const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
const floats = (text) => new Float32Array(bytes(text).buffer);
const indices = (text) => new Uint32Array(bytes(text).buffer);

function fail(message) {
  byId("problem").textContent = message;
  byId("problem").hidden = false;
  document.body.dataset.state = "failed";
}

function loadTexture(address, changed) {
  const texture = new Texture();
  texture.colorSpace = SRGBColorSpace;
  texture.anisotropy = 4;
  if (address) {
    const picture = new Image();
    picture.onload = () => {
      texture.image = picture;
      texture.needsUpdate = true;
      changed();
    };
    picture.onerror = () => fail("The texture of this face could not be decoded.");
    picture.src = address;
  }
  return texture;
}

function cloud(positions, colours, sizeMm, colour) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(positions, 3));
  if (colours) geometry.setAttribute("color", new BufferAttribute(colours, 3, true));
  const look = colours ? { vertexColors: true } : { color: colour };
  const points = new Points(geometry, new PointsMaterial({ sizeAttenuation: false, ...look }));
  points.userData.sizeMm = sizeMm;
  return points;
}

function buildFace(face, changed) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(floats(face.positions), 3));
  geometry.setAttribute("normal", new BufferAttribute(floats(face.normals), 3));
  geometry.setIndex(new BufferAttribute(indices(face.triangles), 1));
  if (face.uv) geometry.setAttribute("uv", new BufferAttribute(floats(face.uv), 2));
  if (face.colours) geometry.setAttribute("color", new BufferAttribute(bytes(face.colours), 3, true));
  const points = floats(face.points);
  const colour = face.uv ? { map: loadTexture(face.texture, changed) } : { vertexColors: true };
  const parts = {
    coloured: new MeshBasicMaterial(colour),
    plain: new MeshLambertMaterial({ color: SKIN }),
    mesh: new Mesh(geometry),
    points: cloud(points, bytes(face.point_colours), Math.sqrt((3 * SEEN_MM2) / Math.max(points.length, 3000))),
    landmarks: cloud(floats(face.landmarks3d), null, LANDMARK_MM, 0x3cff3c),
  };
  parts.landmarks.material.depthTest = false;
  parts.landmarks.renderOrder = 1;
  const model = new Group();
  model.add(parts.mesh, parts.points, parts.landmarks);
  geometry.computeBoundingSphere();
  const middle = geometry.boundingSphere.center;
  model.position.copy(middle).negate();
  parts.group = new Group();
  parts.group.add(model);
  const [r00, r01, r02, r10, r11, r12, r20, r21, r22] = face.rotation;
  const turned = new Matrix4().set(r00, r01, r02, 0, -r10, -r11, -r12, 0, -r20, -r21, -r22, 0, 0, 0, 0, 1);
  parts.group.quaternion.setFromRotationMatrix(turned);
  parts.frame = photographFrame(face, middle.clone().applyMatrix4(turned));
  return parts;
}

// The borders of the photograph in mm around the middle of the head: with them the mesh lies where the face is.
function photographFrame(face, middle) {
  const side = face.photograph_px / face.px_per_mm;
  const [x, y] = face.translation_px.map((shift) => shift / face.px_per_mm);
  const [left, top] = [-(x + middle.x), y - middle.y];
  return { left, right: left + side, top, bottom: top - side };
}

function dispose(parts) {
  for (const object of [parts.mesh, parts.points, parts.landmarks]) object.geometry.dispose();
  for (const material of [parts.coloured, parts.plain, parts.points.material, parts.landmarks.material]) {
    material.map?.dispose();
    material.dispose();
  }
}

function showPhotograph(face) {
  for (const picture of document.querySelectorAll("img")) picture.src = face.photograph;
  byId("photograph").alt = `Photograph of ${face.name}`;
  const drawing = byId("landmarks2d");
  drawing.setAttribute("viewBox", `0 0 ${face.photograph_px} ${face.photograph_px}`);
  drawing.replaceChildren(
    ...face.landmarks2d.map(([x, y]) => {
      const dot = document.createElementNS("http://www.w3.org/2000/svg", "circle");
      for (const [name, value] of [["cx", x], ["cy", y], ["r", face.photograph_px / 160]]) dot.setAttribute(name, value);
      return dot;
    }),
  );
  byId("facts").textContent = face.facts;
}

function start() {
  const faces = JSON.parse(byId("faces").textContent);
  const stage = byId("stage");
  let renderer;
  try {
    renderer = new WebGLRenderer({ alpha: true, antialias: true });
  } catch {
    fail("This browser shows no WebGL; the meshes beside this page open in any 3D viewer.");
    return;
  }
  renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
  renderer.setClearAlpha(0);
  stage.append(renderer.domElement);
  const scene = new Scene();
  const camera = new OrthographicCamera(-1, 1, 1, -1, 1, 2 * DISTANCE_MM);
  const light = new DirectionalLight(0xffffff, 2.4);
  camera.add(light);
  scene.add(camera, new AmbientLight(0xffffff, 0.9));
  const controls = new OrbitControls(camera, renderer.domElement);
  let shown = null;

  function draw() {
    const pxPerMm = (camera.zoom * stage.clientWidth) / (camera.right - camera.left);
    for (const points of [shown.points, shown.landmarks]) points.material.size = points.userData.sizeMm * pxPerMm;
    renderer.render(scene, camera);
  }
  const toggled = (name) => byId(name).checked;
  function restyle() {
    shown.mesh.visible = toggled("show-mesh") || toggled("show-wireframe");
    shown.mesh.material = toggled("show-texture") ? shown.coloured : shown.plain;
    shown.mesh.material.wireframe = toggled("show-wireframe");
    shown.points.visible = toggled("show-points");
    shown.landmarks.visible = toggled("show-landmarks");
    byId("landmarks2d").style.display = toggled("show-landmarks") ? "" : "none";
    draw();
  }
  function reset() {
    controls.target.set(0, 0, 0);
    camera.position.set(0, 0, DISTANCE_MM);
    camera.zoom = 1;
    Object.assign(camera, shown.frame);
    camera.updateProjectionMatrix();
    controls.update();
    document.body.dataset.view = "photograph";
    draw();
  }
  function choose(index) {
    if (shown) {
      scene.remove(shown.group);
      dispose(shown);
    }
    shown = buildFace(faces[index], draw);
    scene.add(shown.group);
    showPhotograph(faces[index]);
    restyle();
    reset();
  }
  function resize() {
    const { clientWidth: width, clientHeight: height } = stage;
    if (!width || !height) return;
    renderer.setSize(width, height);
    draw();
  }

  const chooser = byId("face");
  chooser.replaceChildren(...faces.map((face, index) => new Option(face.name, index)));
  chooser.addEventListener("change", () => choose(Number(chooser.value)));
  for (const box of document.querySelectorAll("#toggles input")) box.addEventListener("change", restyle);
  byId("reset").addEventListener("click", reset);
  controls.addEventListener("change", draw);
  controls.addEventListener("start", () => (document.body.dataset.view = "turned"));
  new ResizeObserver(resize).observe(stage);
  choose(0);
  resize();
  document.body.dataset.state = "ready";
}

try {
  start();
} catch (error) {
  fail(`This page could not be shown: ${error.message}`);
  throw error;
}
