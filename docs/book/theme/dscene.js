// The colours of `dscene` blocks: what highlight.js, which mdBook brings, has to know of the language.
(() => {
    const number = { scope: "number", className: "number", begin: /#[0-9a-fA-F]{6}\b|\b\d[\d_]*(\.\d+)?(e[+-]?\d+)?(deg|rad|turn|%)?/ };
    const inserted = { className: "subst", begin: /\{/, end: /\}/ };
    hljs.registerLanguage("dscene", () => ({
        keywords: {
            keyword:
                "import as let param fn native optimize sweep stage every then save print plot report expect test within " +
                "with in to over for if else and or not camera material texture mesh shape light scene integrator loss",
            literal: "true false",
            type: "scalar int bool string angle vec2 vec3 vec4 color mat3 mat4 rotation transform image optimizer",
        },
        contains: [
            hljs.C_LINE_COMMENT_MODE,
            hljs.COMMENT(/\/\*/, /\*\//, { contains: ["self"] }),
            { className: "string", begin: /"/, end: /"/, contains: [{ begin: /\\./ }, inserted] },
            // The name of a field or of an argument.
            { className: "attr", begin: /\b[a-z_]\w*(?=:)/ },
            { className: "title", begin: /\b[a-z_]\w*(?=\()/, keywords: { keyword: "if not and or in fn param" } },
            number,
        ],
    }));
    // mdBook has passed over the blocks, as it did not know the language yet.
    for (const block of document.querySelectorAll("code.language-dscene")) {
        hljs.highlightBlock(block);
    }
})();
