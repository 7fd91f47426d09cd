// Khronos glTF validator: `node validate.mjs FILE.glb...`; exit status 1 on any error or warning.
import { readFileSync } from "node:fs";
import validator from "gltf-validator";

let bad = 0;
for (const file of process.argv.slice(2)) {
  const report = await validator.validateBytes(new Uint8Array(readFileSync(file)), { uri: file });
  const { numErrors, numWarnings, messages } = report.issues;
  bad += numErrors + numWarnings;
  console.log(`${file}: ${numErrors} errors, ${numWarnings} warnings`);
  for (const m of messages) console.log(`  ${m.code} ${m.pointer ?? ""}: ${m.message}`);
}
process.exit(bad === 0 ? 0 : 1);
