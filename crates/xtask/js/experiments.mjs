// Runs kernels and measures overheads in headless Chromium (Dawn, Tint): the browser's half of `docs/gpu-experiments.md`.
// Usage: node experiments.mjs TRACES EMPTY_WGSL CHROMIUM   (playwright-core must be resolvable from the working folder)
// TRACES is a folder of JSON files that `bundle/gpu/twin/trace.rs` wrote natively: kernel, buffers before and after.

import { readFileSync, readdirSync } from 'node:fs';
import { join } from 'node:path';

import { withPage } from './browser.mjs';

const [folder, empty, chromium] = process.argv.slice(2);
// Of the largest number of a buffer: two correct compilers differ by rounding, a wrong kernel by far more. Inverses of
// blocks amplify rounding by their condition number, as does that of the coarse matrix, singular but for its damping.
const TOLERANCE = { default: 1e-5, precondition_factor: 1e-2, pcg_start: 1e-2, pcg_step: 1e-3 };

// In the page: the kernel once, and how far each buffer it writes is from what it was natively.
async function replay({ kernel, groups, wgsl, buffers }) {
  const adapter = await navigator.gpu?.requestAdapter();
  if (!adapter) throw new Error('this Chromium has no WebGPU adapter');
  globalThis.device ??= await adapter.requestDevice();
  const words = (hex) => Uint32Array.from({ length: hex.length / 8 }, (_, i) => parseInt(hex.substr(8 * i, 8), 16));
  const device = globalThis.device;
  device.pushErrorScope('validation');
  const all = buffers.map(({ kind, before }) => {
    const data = words(before);
    const usage = kind === 'uniform' ? GPUBufferUsage.UNIFORM : GPUBufferUsage.STORAGE;
    const flags = usage | GPUBufferUsage.COPY_DST | GPUBufferUsage.COPY_SRC;
    const buffer = device.createBuffer({ size: Math.max(16, data.byteLength), usage: flags });
    device.queue.writeBuffer(buffer, 0, data);
    return buffer;
  });
  const type = { uniform: 'uniform', read: 'read-only-storage', write: 'storage' };
  const layout = device.createBindGroupLayout({
    entries: buffers.map(({ kind }, binding) => ({
      binding, visibility: GPUShaderStage.COMPUTE, buffer: { type: type[kind] },
    })),
  });
  const pipeline = device.createComputePipeline({
    layout: device.createPipelineLayout({ bindGroupLayouts: [layout] }),
    compute: { module: device.createShaderModule({ code: wgsl }), entryPoint: kernel },
  });
  const entries = all.map((buffer, binding) => ({ binding, resource: { buffer } }));
  const encoder = device.createCommandEncoder();
  const pass = encoder.beginComputePass();
  pass.setPipeline(pipeline);
  pass.setBindGroup(0, device.createBindGroup({ layout, entries }));
  pass.dispatchWorkgroups(...groups);
  pass.end();
  const written = buffers.flatMap(({ kind }, i) => (kind === 'write' ? [i] : []));
  const staging = written.map((i) => {
    const usage = GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST;
    const buffer = device.createBuffer({ size: all[i].size, usage });
    encoder.copyBufferToBuffer(all[i], 0, buffer, 0, all[i].size);
    return buffer;
  });
  device.queue.submit([encoder.finish()]);
  await Promise.all(staging.map((buffer) => buffer.mapAsync(GPUMapMode.READ)));
  const error = await device.popErrorScope();
  if (error) throw new Error(error.message);
  const contents = staging.map((buffer) => buffer.getMappedRange().slice(0));
  const results = written.map((i, k) => {
    const [found, wanted] = [new Uint32Array(contents[k]), words(buffers[i].after)];
    const [a, b] = [new Float32Array(found.buffer), new Float32Array(wanted.buffer)];
    let largest = 1e-30;
    let worst = 0;
    let integers = 0;
    let same = 0;
    for (const v of b) if (Math.abs(v) < 1e29) largest = Math.max(largest, Math.abs(v));
    for (let j = 0; j < wanted.length; j += 1) {
      same += found[j] === wanted[j] ? 1 : 0;
      if (found[j] === wanted[j]) continue;
      // Small whole numbers look like subnormal floats: indices, cells. They must be the same.
      const whole = (w) => w !== 0 && (w & 0x7f800000) === 0;
      if (whole(found[j]) && whole(wanted[j])) integers += 1;
      else worst = Math.max(worst, Math.abs(a[j] - b[j]) / largest);
      if (Number.isNaN(a[j])) worst = Infinity;
    }
    return { name: buffers[i].name, worst, integers, same: same / wanted.length };
  });
  const sums = written.findIndex((i) => buffers[i].name === 'sums');
  let firstColumn = 0;
  if (sums >= 0) {
    const rows = new Float32Array(contents[sums]);
    for (let j = 0; j < rows.length; j += 8) firstColumn += rows[j];
  }
  for (const buffer of [...all, ...staging]) buffer.destroy();
  return { results, firstColumn };
}

// In the page: what dispatches, submissions and read-backs cost when there is nothing to compute.
async function overheads(code) {
  const device = globalThis.device;
  const data = device.createBuffer({
    size: 16384, usage: GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_SRC | GPUBufferUsage.COPY_DST,
  });
  const module = device.createShaderModule({ code });
  const pipeline = device.createComputePipeline({ layout: 'auto', compute: { module, entryPoint: 'empty' } });
  const entries = [{ binding: 0, resource: { buffer: data } }];
  const group = device.createBindGroup({ layout: pipeline.getBindGroupLayout(0), entries });
  const staging = device.createBuffer({ size: 256, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST });
  const submit = (count, groups, copy) => {
    const encoder = device.createCommandEncoder();
    for (let i = 0; i < count; i += 1) {
      const pass = encoder.beginComputePass();
      pass.setPipeline(pipeline);
      pass.setBindGroup(0, group);
      pass.dispatchWorkgroups(groups);
      pass.end();
    }
    if (copy) encoder.copyBufferToBuffer(data, 0, staging, 0, 256);
    device.queue.submit([encoder.finish()]);
  };
  const read = async (count, groups) => {
    submit(count, groups, true);
    await staging.mapAsync(GPUMapMode.READ);
    staging.getMappedRange();
    staging.unmap();
  };
  const time = async (work) => {
    await work();
    let best = Infinity;
    for (let i = 0; i < 20; i += 1) {
      const start = performance.now();
      await work();
      best = Math.min(best, performance.now() - start);
    }
    return best;
  };
  const lines = [];
  for (const [stop, groups, what] of [[0, 1, 'one workgroup'], [1, 64, '64 workgroups that return at once']]) {
    device.queue.writeBuffer(data, 0, new Uint32Array([stop]));
    const wait = (count) => time(async () => {
      submit(count, groups, false);
      await device.queue.onSubmittedWorkDone();
    });
    const [one, hundred, step] = [await wait(1), await wait(100), await time(() => read(90, groups))];
    lines.push(
      `${what}: submit and wait ${(1e3 * one).toFixed(0)} µs, dispatch ${((1e3 * (hundred - one)) / 99).toFixed(1)} µs, ` +
        `90 dispatches and a read-back of 256 bytes ${step.toFixed(2)} ms`,
    );
  }
  lines.push(`read-back alone ${(1e3 * (await time(() => read(0, 0)))).toFixed(0)} µs`);
  return lines;
}

await withPage(chromium, async (page, version) => {
  const { vendor, architecture, description } = await page.evaluate(async () => {
    const { info } = (await navigator.gpu?.requestAdapter()) ?? {};
    return { vendor: info?.vendor, architecture: info?.architecture, description: info?.description };
  });
  console.log(`in Chromium ${version} on ${[vendor, architecture, description].filter(Boolean).join(' ')}`);
  let bad = 0;
  const names = readdirSync(folder).filter((name) => name.endsWith('.json')).sort();
  if (names.length === 0) throw new Error(`no traces in ${folder}`);
  console.log('R7, kernels in both compilers from the same buffers: worst difference of the largest number, equal words');
  for (const name of names) {
    const trace = JSON.parse(readFileSync(join(folder, name), 'utf8'));
    const { results, firstColumn } = await page.evaluate(replay, trace);
    const limit = TOLERANCE[trace.kernel] ?? TOLERANCE.default;
    for (const { name: buffer, worst, integers, same } of results) {
      const wrong = worst > limit || integers > 0;
      bad += wrong ? 1 : 0;
      const share = (100 * same).toFixed(1);
      console.log(`  ${wrong ? 'WRONG ' : ''}${name} ${buffer}: ${worst.toExponential(1)}, ${share} % equal, ${integers} indices off`);
    }
    if (trace.exact !== null) {
      const off = Math.abs(firstColumn / trace.exact - 1);
      console.log(`  ${name}: change of Σ‖r‖² ${firstColumn.toExponential(6)}, off by ${off.toExponential(1)} of f64's`);
    }
  }
  console.log('R6, overheads (smallest of 20)');
  for (const line of await page.evaluate(overheads, readFileSync(empty, 'utf8'))) console.log(`  ${line}`);
  console.log(`${names.length} runs of kernels, ${bad} buffers wrong`);
  process.exitCode = bad === 0 ? 0 : 1;
});
