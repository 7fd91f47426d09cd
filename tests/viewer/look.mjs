// material.glb in a real viewer: headless Chromium with three.js. The square, seen and lit from the flash's place, must
// look like Flashmat's own re-render and like the photo.
//
//   npm ci && node look.mjs MAPS_DIR [PHOTO] [--artefacts DIR]
//
// MAPS_DIR is a folder that `flashmat capture` wrote. Screenshots go to DIR (default ../artefacts). Chromium is found
// as `chromium`, or by the variable CHROMIUM. Exit status: 0 alike, 1 not alike, 77 no Chromium (nothing tested).
import { spawn, spawnSync } from "node:child_process";
import { createReadStream, existsSync, mkdirSync, mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { readFileSync } from "node:fs";
import { createServer } from "node:http";
import { tmpdir } from "node:os";
import { basename, extname, join, normalize, resolve } from "node:path";
import { fileURLToPath } from "node:url";
import { parseArgs } from "node:util";

const HERE = fileURLToPath(new URL(".", import.meta.url));
// glTF viewers use another G term and reduce the diffuse part by the Fresnel term: alike, not the same.
const RENDER_LIMIT = 0.04;
const PHOTO_SLACK = 0.03;
// F0 from which the export takes a material for a metal: half-way from 0.05 to 0.5.
const METAL_F0 = 0.275;
const TIMEOUT_MS = 120_000;
const TYPES = { ".html": "text/html", ".mjs": "text/javascript", ".js": "text/javascript", ".json": "application/json", ".png": "image/png" };

const { values, positionals } = parseArgs({
  allowPositionals: true,
  options: { artefacts: { type: "string", default: join(HERE, "../artefacts") } },
});
const [maps, photo] = positionals.map((p) => resolve(p));
if (!maps) {
  console.error("usage: node look.mjs MAPS_DIR [PHOTO] [--artefacts DIR]");
  process.exit(2);
}
const chromium = process.env.CHROMIUM ?? "chromium";
if (spawnSync(chromium, ["--version"]).status !== 0) {
  console.log("NOT RUN: no Chromium (apt-get install chromium, or set CHROMIUM)");
  process.exit(77);
}
const artefacts = join(values.artefacts, basename(maps));
mkdirSync(artefacts, { recursive: true });

function fileFor(path) {
  if (path === "/maps/photo") return photo;
  if (path.startsWith("/maps/")) return join(maps, normalize(path.slice(5)));
  return join(HERE, normalize(path === "/" ? "/page.html" : path));
}

const body = async (request) => {
  const chunks = [];
  for await (const chunk of request) chunks.push(chunk);
  return Buffer.concat(chunks);
};

const result = await new Promise((done) => {
  const server = createServer(async (request, response) => {
    const { pathname } = new URL(request.url, "http://localhost");
    if (request.method === "POST") {
      const data = await body(request);
      response.end();
      if (pathname === "/result") finish(JSON.parse(data));
      else if (pathname === "/failure") finish({ failure: data.toString() });
      else writeFileSync(join(artefacts, basename(pathname)), data);
      return;
    }
    const file = fileFor(pathname);
    if (!file || !existsSync(file)) {
      response.writeHead(404).end();
      return;
    }
    response.setHeader("Content-Type", TYPES[extname(file)] ?? "application/octet-stream");
    createReadStream(file).pipe(response);
  });
  const profile = mkdtempSync(join(tmpdir(), "flashmat-viewer-"));
  let browser;
  const timer = setTimeout(() => finish({ failure: `no answer from the browser in ${TIMEOUT_MS / 1000} s` }), TIMEOUT_MS);
  const finish = (value) => {
    clearTimeout(timer);
    browser.once("exit", () => rmSync(profile, { recursive: true, force: true, maxRetries: 3 }));
    browser.kill();
    server.close();
    server.closeAllConnections();
    done(value);
  };
  server.listen(0, "127.0.0.1", () => {
    const address = `http://127.0.0.1:${server.address().port}/`;
    // No GPU needed: SwiftShader renders WebGL on the CPU.
    const flags = ["--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
      "--disable-dev-shm-usage", "--no-first-run", `--user-data-dir=${profile}`];
    browser = spawn(chromium, [...flags, address], { stdio: "ignore" });
    browser.once("error", (error) => finish({ failure: String(error) }));
  });
});

if (result.failure) {
  console.error(`failed: ${result.failure}`);
  process.exit(1);
}
const report = JSON.parse(readFileSync(join(maps, "report.json")));
// The export's metals have no diffuse part and a coloured F0, Flashmat's a white one and a diffuse part: pictures only.
const metal = report.f0 >= METAL_F0;
const checks = metal ? [] : [["render.png", RENDER_LIMIT], ["photo", report.residual + PHOTO_SLACK]];
let bad = 0;
for (const [name, limit] of checks) {
  if (result[name] === undefined) continue;
  const ok = result[name] <= limit;
  bad += ok ? 0 : 1;
  console.log(`${ok ? "ok" : "NOT ALIKE"}: viewer against ${name}: RMSE ${result[name].toFixed(4)}, limit ${limit.toFixed(4)}`);
}
if (metal) console.log("NOT COMPARED: a metal, which glTF models otherwise; see the screenshots");
console.log(`${result.renderer}; screenshots in ${artefacts}`);
process.exit(bad === 0 ? 0 : 1);
