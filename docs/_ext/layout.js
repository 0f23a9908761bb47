// Opens PAGES one after the other in a frame of several WIDTHS, and logs what is wrong with them.
// check_site.py sets these names and reads the log.

const frame = document.createElement("iframe");
frame.style.cssText = "border: 0; height: 900px";
document.body.append(frame);

function problems(page) {
  const wrong = [];
  for (const width of WIDTHS) {
    frame.style.width = `${width}px`;
    const excess = page.documentElement.scrollWidth - width;
    if (excess > 1) wrong.push(`is ${excess} pixels too wide for ${width}: ${widest(page, width)}`);
    // A scene fills the frame that it is shown in.
    const below = page.URL.includes("/scenes/") ? page.documentElement.scrollHeight - frame.clientHeight : 0;
    if (below > 1) wrong.push(`is ${below} pixels too tall at a width of ${width}`);
  }
  for (const link of page.querySelectorAll("article a[href]"))
    if (!name(link)) wrong.push(`has a link without text: ${link.getAttribute("href")}`);
  for (const image of page.querySelectorAll("article img")) {
    if (!image.naturalWidth) wrong.push(`has a picture that cannot be drawn: ${image.src}`);
    if (!image.alt) wrong.push(`has a picture without a description: ${image.src}`);
  }
  for (const code of page.querySelectorAll(":is(.highlight-python, .highlight-py, .highlight-sh) pre"))
    for (const line of code.textContent.split("\n"))
      if (line.length > LONGEST) wrong.push(`has ${line.length} characters in a line of code: ${line}`);
  let level = 0;
  for (const heading of page.querySelectorAll("article :is(h1, h2, h3, h4, h5, h6)")) {
    const next = Number(heading.tagName[1]);
    if (next > level + 1 || (next === 1 && level)) wrong.push(`has ${heading.tagName} out of order: ${heading.textContent}`);
    level = next;
  }
  return wrong;
}

// What a link is called: its text, or the description of its picture.
const name = (link) =>
  link.textContent.trim() || link.getAttribute("aria-label") || link.querySelector("img")?.alt;

// The first element that ends beyond the width and does not scroll by itself.
function widest(page, width) {
  const scrolls = (e) => e && (getComputedStyle(e).overflowX !== "visible" || scrolls(e.parentElement));
  for (const element of page.querySelectorAll("article *"))
    if (element.getBoundingClientRect().right > width + 1 && !scrolls(element))
      return element.outerHTML.slice(0, 80);
  return "";
}

async function check() {
  for (const page of PAGES) {
    console.log(`PAGE ${page}`);
    frame.style.width = `${WIDTHS[0]}px`;
    await new Promise((loaded) => {
      frame.onload = loaded;
      frame.src = page;
    });
    for (const line of problems(frame.contentDocument)) console.log(`WRONG ${line.replace(/\s+/g, " ")}`);
  }
  console.log("PAGE end");
}

check();
