// In the browser: the square of material.glb, seen and lit from (0,0,1), as Flashmat's renderer has it.
import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

const post = (path, body) => fetch(path, { method: "POST", body });

async function main() {
  const report = await (await fetch("/maps/report.json")).json();
  const size = 512;
  const renderer = new THREE.WebGLRenderer({ antialias: false, preserveDrawingBuffer: true });
  renderer.setSize(size, size);
  renderer.toneMapping = THREE.NoToneMapping;
  document.body.append(renderer.domElement);
  const camera = new THREE.PerspectiveCamera(report.fov_deg, 1, 0.1, 10);
  camera.position.set(0, 0, 1);
  const scene = (await new GLTFLoader().loadAsync("/maps/material.glb")).scene;
  // Irradiance is intensity / distance²; Flashmat's is pi * strength / distance².
  const flash = new THREE.PointLight(0xffffff, Math.PI * report.light_scale, 0, 2);
  flash.position.set(...report.flash);
  scene.add(flash);
  // Even light of irradiance pi * room * the flash's, which the diffuse part reflects.
  const room = new THREE.AmbientLight(0xffffff, Math.PI * report.light_scale * report.room_light);
  scene.add(room);

  const picture = (light) => {
    if (light) flash.position.set(...light);
    renderer.render(scene, camera);
    return pixelsOf(renderer.domElement, report.size);
  };
  const lit = picture();
  await post("/picture/flash.png", await png(renderer.domElement));
  const result = { renderer: glName(renderer) };
  for (const name of ["render.png", "photo"]) {
    const response = await fetch(`/maps/${name}`);
    if (response.ok) {
      const image = await createImageBitmap(await response.blob());
      result[name] = rmse(lit, pixelsOf(image, report.size));
    }
  }
  picture([-0.75, 0.4, 0.6]);
  await post("/picture/side.png", await png(renderer.domElement));
  await post("/result", JSON.stringify(result));
}

/** The central square of a picture, sRGB codes at `size`. */
function pixelsOf(image, size) {
  const canvas = new OffscreenCanvas(size, size);
  const context = canvas.getContext("2d");
  context.imageSmoothingQuality = "high";
  const side = Math.min(image.width, image.height);
  context.drawImage(image, (image.width - side) / 2, (image.height - side) / 2, side, side, 0, 0, size, size);
  return context.getImageData(0, 0, size, size).data;
}

/** Root mean square difference of codes in [0,1], alpha left out. */
function rmse(a, b) {
  let sum = 0;
  for (let i = 0; i < a.length; i++) if (i % 4 !== 3) sum += ((a[i] - b[i]) / 255) ** 2;
  return Math.sqrt(sum / (0.75 * a.length));
}

const png = (canvas) => new Promise((done) => canvas.toBlob(done, "image/png"));

function glName(renderer) {
  const gl = renderer.getContext();
  const info = gl.getExtension("WEBGL_debug_renderer_info");
  return info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : "unknown";
}

main().catch((error) => post("/failure", String(error?.stack ?? error)));
