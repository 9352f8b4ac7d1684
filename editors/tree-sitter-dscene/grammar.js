// The grammar for editors: colours, folds and selections while one writes.
//
// `grammar/dscene.pest` says what the language is. This one follows it rule by rule and accepts all that it accepts; it need not refuse
// what that one refuses, since errors are told by `dsl lsp`; where it is more lenient, its tables are smaller. A test reads every script of
// the repository with both.

// From loose to tight, as `src/syntax/build/expr.rs` has them.
const BINDS = {
  with: 1,
  lambda: 2,
  pipe: 3,
  if: 4,
  or: 5,
  and: 6,
  not: 7,
  compare: 8,
  range: 9,
  add: 10,
  multiply: 11,
  negate: 12,
  power: 13,
  operand: 14,
};

const KINDS = ["camera", "material", "texture", "mesh", "shape", "light", "medium", "scene", "integrator"];

const separated = (rule) => seq(rule, repeat(seq(",", rule)));
// `(a, b,)`
const listed = (rule) => optional(seq(separated(rule), optional(",")));
// Commas between what stands in braces may be left out.
const braced = (rule) => seq("{", repeat(seq(rule, optional(","))), "}");

module.exports = grammar({
  name: "dscene",

  word: ($) => $.identifier,

  extras: ($) => [/[\s\uFEFF]/, $.comment, $.doc_comment, $.block_comment],

  // What takes more than a regular expression: src/scanner.c.
  externals: ($) => [$.block_comment, $._call_open, $._index_open, $.string_text, $._never],

  supertypes: ($) => [$._expression, $._statement],

  conflicts: ($) => [
    // `(x, y) => …` and `(x)`, until the bracket is closed.
    [$.lambda_parameters, $._operand],
  ],

  rules: {
    source_file: ($) => repeat($._statement),

    _statement: ($) =>
      choice(
        $.import,
        $.let,
        $.param,
        $.function,
        $.native_function,
        $.loss,
        $.kind,
        $.optimize,
        $.save,
        $.print,
        $.plot,
        $.expect,
        $.report,
        $.sweep,
        $.test,
      ),

    // Declarations

    import: ($) =>
      seq(
        "import",
        field("from", choice($.string, $.module_path)),
        optional(seq("as", field("alias", $.identifier))),
      ),
    module_path: ($) => seq($.identifier, repeat(seq(".", $.identifier))),

    let: ($) =>
      seq(
        "let",
        field("name", $.identifier),
        optional(seq(":", field("type", $._type))),
        "=",
        field("value", choice($._expression, $.block)),
      ),

    loss: ($) => seq("loss", field("name", $.identifier), "=", field("value", $._expression)),

    param: ($) =>
      seq(
        "param",
        field("name", $.identifier),
        optional(seq(":", field("type", $._type))),
        choice(seq("=", field("value", $._expression), optional($.prior)), $.prior),
        optional($.bounds),
        optional($.fields),
      ),
    prior: ($) => seq("~", $._expression),
    // `in 0..1`, `in 0..`, `in ..1`
    bounds: ($) => seq("in", choice($.open_range, $._expression)),

    function: ($) =>
      seq(
        "fn",
        field("name", $.identifier),
        $.parameters,
        optional(seq(":", field("type", $._type))),
        field("body", choice(seq("=", choice($._expression, $.block)), $.block)),
      ),
    native_function: ($) =>
      prec.right(
        seq(
          "native",
          "fn",
          field("name", $.identifier),
          $.parameters,
          optional(seq(":", field("type", $._type))),
        ),
      ),
    parameters: ($) => seq("(", listed($.parameter), ")"),
    parameter: ($) =>
      seq(
        field("name", $.identifier),
        optional(seq(":", field("type", $._type))),
        optional($.domain),
        optional(seq("=", field("default", $._expression))),
      ),
    // `in 0..1`, `in 0..`, `in 0<..<1`
    domain: ($) => seq("in", optional($._domain_end), $.domain_dots, optional($._domain_end)),
    _domain_end: ($) => seq(optional("-"), $.number),
    domain_dots: (_) => /<?\.\.<?/,

    block: ($) => seq("{", repeat($.let), $._expression, "}"),

    // `camera eye { … }`, `mesh ball = …`
    kind: ($) =>
      seq(
        field("kind", alias(choice(...KINDS), $.kind_word)),
        field("name", $.identifier),
        choice($.fields, seq(optional(seq(":", field("type", $._type))), "=", field("value", $._expression))),
      ),
    fields: ($) => braced($.field),
    field: ($) => seq(field("name", $.identifier), ":", field("value", $._expression)),

    // Actions

    optimize: ($) => seq("optimize", field("loss", $._expression), optional($.optimize_body)),
    optimize_body: ($) => braced(choice($.stage, $.every, $.field)),
    stage: ($) => seq("stage", field("name", $.identifier), braced(choice($.then, $.field))),
    then: ($) => seq("then", braced($.renewal)),
    renewal: ($) =>
      seq(
        choice("param", "let", alias(choice(...KINDS), $.kind_word)),
        field("name", $.identifier),
        "=",
        field("value", $._expression),
      ),
    every: ($) => seq("every", $._expression, "{", repeat($._statement), "}"),
    save: ($) => seq("save", field("value", $._expression), "to", field("to", $._expression)),
    print: ($) => seq("print", separated($._expression)),
    plot: ($) =>
      seq(
        "plot",
        separated($._expression),
        repeat(choice(seq("over", field("over", $._expression)), seq("to", field("to", $._expression)))),
        optional($.fields),
      ),
    expect: ($) => seq("expect", $._expression, optional(seq(",", field("reason", $._expression)))),
    sweep: ($) =>
      seq("sweep", separated($.swept), optional(","), "{", repeat($._statement), "}"),
    swept: ($) => seq(field("name", $.identifier), "in", field("values", $._expression)),
    test: ($) => seq("test", field("name", $.string), "{", repeat($._statement), "}"),
    report: ($) => seq("report", braced($.reported)),
    reported: ($) => seq(field("name", $.identifier), optional(seq(":", field("value", $._expression)))),

    // Types

    _type: ($) => choice($.union_type, $._type_atom),
    union_type: ($) => prec.left(seq($._type, "|", $._type_atom)),
    _type_atom: ($) =>
      choice(
        alias($.identifier, $.type_name),
        $.function_type,
        $.record_type,
        $.word_type,
        $.array_type,
      ),
    array_type: ($) => prec(1, seq($._type_atom, "[", optional(choice($.number, $.identifier)), "]")),
    function_type: ($) => prec(-1, seq("(", optional(separated($._type)), ")", "=>", $._type)),
    record_type: ($) => braced($.type_field),
    type_field: ($) => seq(field("name", $.identifier), ":", field("type", $._type)),
    word_type: (_) => /"[A-Za-z_][A-Za-z0-9_]*"/,

    // Expressions

    _expression: ($) => choice($.with, $.pipe, $.if, $.lambda, $.unary, $.binary, $.range, $._operand),

    with: ($) => prec.left(BINDS.with, seq($._expression, "with", braced($.replacement))),
    replacement: ($) => seq($.target, ":", field("value", $._expression)),
    target: ($) =>
      seq($.identifier, repeat(choice(seq(".", $.identifier), seq("[", choice(seq(optional("-"), $.number), $.identifier), "]")))),

    pipe: ($) => prec.left(BINDS.pipe, seq($._expression, "|>", $._expression)),

    lambda: ($) =>
      prec.right(
        BINDS.lambda,
        seq(
          field("parameters", choice($.identifier, $.lambda_parameters)),
          "=>",
          field("body", choice($._expression, $.block)),
        ),
      ),

    lambda_parameters: ($) => seq("(", listed($.identifier), ")"),

    if: ($) =>
      prec.right(
        BINDS.if,
        seq(
          "if",
          field("condition", $._expression),
          "then",
          field("then", $._expression),
          "else",
          field("else", $._expression),
        ),
      ),

    unary: ($) =>
      choice(
        prec(BINDS.negate, seq("-", $._expression)),
        prec(BINDS.not, seq("not", $._expression)),
      ),

    binary: ($) => {
      const left = (binds, operator) =>
        prec.left(binds, seq($._expression, field("operator", operator), $._expression));
      return choice(
        left(BINDS.or, "or"),
        left(BINDS.and, "and"),
        left(BINDS.compare, choice("==", "!=", "<", "<=", ">", ">=", "≈", "~=", "within")),
        left(BINDS.add, choice("+", "-")),
        left(BINDS.multiply, choice("*", "/", "@")),
        prec.right(BINDS.power, seq($._expression, field("operator", choice("^", "of")), $._expression)),
      );
    },
    range: ($) => prec.left(BINDS.range, seq($._expression, choice("..", "..="), $._expression)),
    // Where only one end is said: in brackets and behind `in`.
    open_range: ($) =>
      choice(
        // Braces behind the dots are not the other end: `param x = 1 in 0.. { lr: 2 }`.
        prec.left(BINDS.range, seq($._expression, "..")),
        prec.left(BINDS.range, seq(choice("..", "..="), $._expression)),
      ),

    _operand: ($) =>
      choice(
        $.identifier,
        $.number,
        $.color,
        $.string,
        $.boolean,
        $.array,
        $.parenthesized,
        $.record,
        $.call,
        $.index,
        $.member,
      ),

    // A bracket that opens on a new line begins something new; a dot may go on there.
    call: ($) =>
      prec(BINDS.operand, seq(field("function", $._operand), alias($._call_open, "("), listed($._argument), ")")),
    _argument: ($) => choice($.named_argument, $._expression),
    named_argument: ($) => seq(field("name", $.identifier), ":", field("value", $._expression)),
    index: ($) =>
      prec(
        BINDS.operand,
        seq($._operand, alias($._index_open, "["), separated(choice($._expression, $.open_range, "..")), "]"),
      ),
    member: ($) => prec(BINDS.operand, seq($._operand, ".", field("name", $.identifier))),

    parenthesized: ($) => seq("(", $._expression, ")"),
    // `{ x }` is a record where both may stand; what makes a block is its `let`.
    record: ($) => prec(1, braced($.entry)),
    entry: ($) =>
      prec(1, choice(seq(field("name", $.identifier), ":", field("value", $._expression)), field("name", $.identifier))),
    array: ($) =>
      seq(
        "[",
        optional(
          choice(
            seq($.block, repeat1($.for)),
            seq($._expression, choice(repeat1($.for), seq(repeat(seq(",", $._expression)), optional(",")))),
          ),
        ),
        "]",
      ),
    for: ($) =>
      seq(
        "for",
        separated(field("name", $.identifier)),
        "in",
        $._expression,
        optional(seq("if", $._expression)),
      ),

    boolean: (_) => choice("true", "false"),
    number: ($) => seq(/[0-9][0-9_]*(\.[0-9][0-9_]*)?([eE][+-]?[0-9]+)?/, optional($.unit)),
    unit: (_) => token.immediate(/%|[A-Za-z_][A-Za-z0-9_]*/),
    color: (_) => /#[A-Za-z0-9]+/,

    // The scanner reads what stands between, white space too.
    string: ($) => seq('"', repeat(choice($.string_text, $.escape, $.interpolation)), '"'),
    escape: (_) => token.immediate(/\\(u\{[0-9a-fA-F]*\}|[^\n])/),
    interpolation: ($) => seq("{", $._expression, optional(seq(":", $.format)), "}"),
    format: (_) => token.immediate(/[^}"\n]+/),

    identifier: (_) => /[A-Za-z_][A-Za-z0-9_]*/,

    comment: (_) => token(seq("//", /[^\n]*/)),
    // Precedence counts before length: nothing that begins an ordinary comment may match, such as the first three of four slashes.
    doc_comment: (_) => token(prec(1, seq("///", /[^\/\n][^\n]*/))),
  },
});
