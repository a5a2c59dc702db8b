// A streamed scene beside a mesh of the page's own. Address: `?src=ws://host:port/scene`.

import * as THREE from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';
import { StreamedGroup } from './streamed-group.js';

const src = new URLSearchParams(location.search).get('src') ?? 'ws://localhost:4434/';
const message = document.getElementById('message');

const renderer = new THREE.WebGLRenderer({ antialias: true });
renderer.setPixelRatio(devicePixelRatio);
document.body.append(renderer.domElement);
const camera = new THREE.PerspectiveCamera(50, 1, 0.1, 1000);
addEventListener('resize', resize);
resize();
const controls = new OrbitControls(camera, renderer.domElement);
const scene = new THREE.Scene();
const sun = new THREE.DirectionalLight();
const sky = new THREE.AmbientLight();
scene.add(sun, sky);

// What is sent first is for a picture of this size from the scene's start camera.
const { x: width, y: height } = pictureSize();
const streamed = new StreamedGroup(src, { width, height });
scene.add(streamed);
const { connection } = streamed;

/** The page's own mesh, of a size for the scene and left of its middle in the first picture. */
const own = new THREE.Mesh(
  new THREE.TorusKnotGeometry(1, 0.3, 128, 24),
  new THREE.MeshStandardMaterial({ color: '#ff5030', roughness: 0.4 }),
);

connection.addEventListener('scene', ({ detail: { camera: start, light, background } }) => {
  camera.position.fromArray(start.eye);
  camera.up.fromArray(start.up);
  camera.fov = start.fov;
  controls.target.fromArray(start.target);
  const distance = camera.position.distanceTo(controls.target);
  [camera.near, camera.far] = [distance / 1000, distance * 1000];
  controls.update();
  camera.updateProjectionMatrix();
  camera.updateMatrixWorld();
  sun.position.fromArray(light.direction).add(controls.target);
  sun.target.position.copy(controls.target);
  sun.target.updateMatrixWorld();
  // three.js divides by π what a surface scatters, the scene does not.
  sun.color.setRGB(...light.color).multiplyScalar(Math.PI);
  sky.color.setRGB(...light.ambient).multiplyScalar(Math.PI);
  scene.background = new THREE.Color(...background);
  const left = new THREE.Vector3(-1, 0, 0).applyQuaternion(camera.quaternion);
  own.scale.setScalar(distance / 16);
  own.position.copy(controls.target).addScaledVector(left, distance * 0.6);
  scene.add(own);
});
connection.addEventListener('firstframe', () => renderer.setAnimationLoop(draw));
connection.addEventListener('progress', ({ detail }) => {
  const state = detail.message ?? (detail.settled ? 'settled' : 'refining');
  message.textContent = `${state}, ${((detail.bytes ?? 0) / 1e3).toFixed(0)} kB, ${streamed.faces} faces`;
});
connection.addEventListener('error', ({ detail }) => (message.textContent = detail));

function draw() {
  controls.update();
  streamed.follow(camera, pictureSize());
  renderer.render(scene, camera);
}

/** Size of the picture in pixels of the device. */
function pictureSize() {
  return renderer.getDrawingBufferSize(new THREE.Vector2());
}

function resize() {
  camera.aspect = innerWidth / innerHeight;
  camera.updateProjectionMatrix();
  renderer.setSize(innerWidth, innerHeight);
}

/** For scripts and tests. */
window.example = { THREE, scene, streamed, own, camera, controls, renderer, draw };
