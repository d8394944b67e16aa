// Build a navmesh of a GLB file with Recast, and test places and paths on it. Reads a JSON request on the standard input:
// {glb, bounds: [[x, y, z], [x, y, z]], radius, places: [[x, y, z], ...], paths: [[[x, y, z], ...], ...]} in glTF's
// frame, meters. Writes {walkable: [0 or 1, ...], reached: [0 or 1, ...]}. Packages: @recast-navigation/core and
// @recast-navigation/generators.
import fs from 'node:fs';
import { createRequire } from 'node:module';
import { pathToFileURL } from 'node:url';

const request = JSON.parse(fs.readFileSync(0, 'utf8'));
const require = createRequire(pathToFileURL(`${process.cwd()}/`));
const { init, NavMeshQuery } = await import(pathToFileURL(require.resolve('@recast-navigation/core')));
const { generateSoloNavMesh } = await import(pathToFileURL(require.resolve('@recast-navigation/generators')));
await init();

const data = fs.readFileSync(request.glb);
const length = data.readUInt32LE(12);
const root = JSON.parse(data.subarray(20, 20 + length).toString());
const body = data.subarray(28 + length);
const array = (index, type, width) => {
  const accessor = root.accessors[index];
  const start = body.byteOffset + root.bufferViews[accessor.bufferView].byteOffset;
  return new type(body.buffer.slice(start, start + accessor.count * width * 4));
};
const primitive = root.meshes[0].primitives[0];
const places = array(primitive.attributes.POSITION, Float32Array, 3);
const triangles = array(primitive.indices, Uint32Array, 1);

const cell = 0.05;
const built = generateSoloNavMesh(places, triangles, {
  bounds: request.bounds, cs: cell, ch: cell, walkableRadius: Math.ceil(request.radius / cell - 1e-9), walkableHeight: Math.ceil(1.5 / cell),
  walkableClimb: 4, walkableSlopeAngle: 45, minRegionArea: 20, mergeRegionArea: 20, maxEdgeLen: 240,
  maxSimplificationError: 1.3, maxVertsPerPoly: 6, detailSampleDist: 6, detailSampleMaxError: 1,
});
if (!built.success) throw new Error(built.error);
const query = new NavMeshQuery(built.navMesh);
const at = ([x, y, z]) => ({ x, y, z });
const near = (place, reach) => {
  const found = query.findNearestPoly(at(place), { halfExtents: { x: reach, y: 0.4, z: reach } });
  return found.success && found.nearestRef ? found.nearestPoint : null;
};
const walkable = request.places.map((place) => {
  const found = near(place, 0.01);
  return found && Math.hypot(found.x - place[0], found.z - place[2]) < 0.011 ? 1 : 0;
});
const joined = (a, b) => {
  if (!near(a, 0.3) || !near(b, 0.3)) return false;
  const found = query.computePath(at(a), at(b), { halfExtents: { x: 0.3, y: 0.4, z: 0.3 } });
  const end = found.path[found.path.length - 1];
  return found.success && end !== undefined && Math.hypot(end.x - b[0], end.z - b[2]) < 0.35;
};
const reached = request.paths.map((path) => (path.slice(1).every((place, i) => joined(path[i], place)) ? 1 : 0));
console.log(JSON.stringify({ walkable, reached }));
