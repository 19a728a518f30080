// Headless Chromium with WebGPU, for whoever has something to run in it.

import { createRequire } from 'node:module';
import { createServer } from 'node:http';
import { join } from 'node:path';

const { chromium } = createRequire(join(process.cwd(), 'package.json'))('playwright-core');

// Opens a page on which WebGPU exists, hands it to `work`, and closes everything.
export async function withPage(executablePath, work) {
  // WebGPU exists in secure contexts only; localhost is one.
  const server = createServer((_, response) => response.end('<!doctype html>')).listen(0, '127.0.0.1');
  const browser = await chromium.launch({
    executablePath,
    args: [
      '--no-sandbox', '--enable-unsafe-webgpu', '--disable-quic', '--no-first-run', '--disable-background-networking',
      '--disable-component-update', '--disable-sync',
    ],
  });
  try {
    const page = await browser.newPage();
    await page.goto(`http://127.0.0.1:${server.address().port}/`);
    return await work(page, browser.version());
  } finally {
    await browser.close();
    server.close();
  }
}
