// Compiles WGSL files as compute pipelines in headless Chromium, whose compiler (Tint) refuses what Naga accepts.
// A file is called as its entry point, with the flags of its variant behind dashes.
// Usage: node compile_shaders.mjs FOLDER CHROMIUM   (playwright-core must be resolvable from the working folder)

import { readFileSync, readdirSync } from 'node:fs';
import { join } from 'node:path';

import { withPage } from './browser.mjs';

const [folder, executablePath] = process.argv.slice(2);
const shaders = readdirSync(folder)
  .filter((name) => name.endsWith('.wgsl'))
  .sort()
  .map((name) => ({ name: name.replace('.wgsl', ''), code: readFileSync(join(folder, name), 'utf8') }));
if (shaders.length === 0) throw new Error(`no shaders in ${folder}`);

await withPage(executablePath, async (page, version) => {
  const failures = await page.evaluate(async (list) => {
    const adapter = await navigator.gpu?.requestAdapter();
    if (!adapter) return ['this Chromium has no WebGPU adapter'];
    // No limits asked for: WebGPU's defaults.
    const device = await adapter.requestDevice();
    const found = [];
    for (const { name, code } of list) {
      device.pushErrorScope('validation');
      const module = device.createShaderModule({ label: name, code });
      const { messages } = await module.getCompilationInfo();
      for (const m of messages.filter((m) => m.type === 'error')) found.push(`${name}:${m.lineNum}: ${m.message}`);
      device.createComputePipeline({ label: name, layout: 'auto', compute: { module, entryPoint: name.split('-')[0] } });
      const error = await device.popErrorScope();
      if (error) found.push(`${name}: ${error.message}`);
    }
    return found;
  }, shaders);
  for (const failure of failures) console.error(failure);
  console.log(`${shaders.length} kernels compiled in Chromium ${version}, ${failures.length} errors`);
  process.exitCode = failures.length === 0 ? 0 : 1;
});
